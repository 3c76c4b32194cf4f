#include "core.h"
#include <random>
using std::map;
// explore FLATS TRACE GEO [k=v ...]: a simulated rescue in flats with the map's own rules and recorded errors of rays.
struct Walk{double r,v,p;vector<array<double,2>> w;array<double,2> at(double t)const{vector<double> L;double T=0;int n=w.size();for(int i=0;i+1<n;i++){double d=hypot(w[i+1][0]-w[i][0],w[i+1][1]-w[i][1]);L.push_back(d);}for(double d:L)T+=d/v+p;double q=fmod(t,2*T);bool back=q>=T;if(back)q-=T;for(int i=0;i<(int)L.size();i++){int j=back?(int)L.size()-1-i:i;auto a=back?w[j+1]:w[j],b=back?w[j]:w[j+1];if(q<p)return a;q-=p;if(q<L[j]/v){double f=q*v/L[j];return {a[0]+f*(b[0]-a[0]),a[1]+f*(b[1]-a[1])};}q-=L[j]/v;}return back?w[0]:w[n-1];}};
struct Flat{vector<Walk> wk;string k;double x,y,h,bat,sx,sy,sh,W,D;vector<Seg> s;};
map<string,double> V;
double par(const char*k,double d){auto i=V.find(k);return i==V.end()?d:i->second;}
mt19937 R;
double U(){return uniform_real_distribution<>(0,1)(R);}double G(double s){return normal_distribution<>(0,1)(R)*s;}
struct Grp{array<double,12> td;array<Ray,12> r;};
map<int,vector<Grp>> lib;int kb(double d){return (int)floor(log(max(d,.1))/log(1.25));}
double castw(const Flat&f,double x,double y,double a,double T){double r=castray(f.s,x,y,a);for(auto&w:f.wk){auto p=w.at(T);double dx=p[0]-x,dy=p[1]-y,al=dx*cos(a)+dy*sin(a),ac=-dx*sin(a)+dy*cos(a);if(al>0&&fabs(ac)<w.r)r=min(r,max(.02,al-sqrt(w.r*w.r-ac*ac)));}return r;}
bool blockedLOS(const Flat&f,double x,double y,double x2,double y2){double a=atan2(y2-y,x2-x),d=hypot(x2-x,y2-y);return castray(f.s,x,y,a)<d-1e-3;}
bool hears(const Flat&f,double x,double y,double range){double h=f.sh*M_PI/180,bx=f.sx+.1*cos(h),by=f.sy+.1*sin(h);double d=hypot(x-bx,y-by),off=fabs(wrap(atan2(y-by,x-bx)-h));
 if(d>range)return false;if(!(off<=70*M_PI/180||(d<.8&&off<=M_PI/2)))return false;return !blockedLOS(f,bx,by,x,y);}
double near_wall(const Flat&f,double x,double y){double r=9;for(auto&s:f.s){double dx=s[2]-s[0],dy=s[3]-s[1],L=dx*dx+dy*dy,t=L>0?((x-s[0])*dx+(y-s[1])*dy)/L:0;t=min(1.,max(0.,t));r=min(r,hypot(x-s[0]-t*dx,y-s[1]-t*dy));}return r;}
double SIGHT=3;int INTO=6,DIRS=30;double LEASTG=.5,SCOST=6,POW=1;int NARROW=4,NEARC=3;double GIVEN=.4;
const int BES[4]={N,-N,1,-1};const int TWO[8]={2*N,-2*N,2,-2,N+1,N-1,-N+1,-N-1};
struct Ex:Map{vector<int> gcount;int gdrop=0;int stuck=0;vector<Pose> poses;void clear(){fill(e.begin(),e.end(),0);fill(f.begin(),f.end(),-1);fill(searched.begin(),searched.end(),0);given.clear();tried.clear();poses.clear();}vector<char> searched;vector<array<double,2>> given,tried;vector<vector<int>> all,some;
 Ex():searched(N*N,0){{double s0=SIGHT;SIGHT=par("mark",s0);all=lines(6*DIRS);SIGHT=s0;}some=lines(DIRS);}
 vector<vector<int>> lines(int n){vector<vector<int>> v;for(int d=1;d<=n;d++){double a=d*2*M_PI/n;vector<int> l;for(int w=1;w<=(int)(SIGHT/CELL+1e-9);w++)l.push_back((int)floor(cos(a)*w+.5)*N+(int)floor(sin(a)*w+.5));v.push_back(l);}return v;}
 bool anyocc(int c,const int*o,int n){for(int i=0;i<n;i++)if(occ(c+o[i]))return true;return false;}
 bool room(int c){return !anyocc(c,BES,4);}
 void mid(int c,double&x,double&y){x=(c/N-MID+.5)*CELL;y=(c%N-MID+.5)*CELL;}
 template<class F> void sight(int from,const vector<vector<int>>&L,F v){for(auto&l:L){int u=0,w=0;for(int o:l){w++;int c=from+o;if(c<3*N||c>=N*(N-3))break;double q=e[c];if(q>LEAST)break;else if(q>=-LEAST){u++;if(u>INTO||!room(c))break;}v(c,w);}}}
 void search(Pose p){sight(cell(p.x,p.y),all,[&](int c,int){searched[c]=1;});tried.push_back({p.x,p.y});}
 double gain(int c){double s=0;sight(c,some,[&](int q,int w){s+=searched[q]?0:w;});return s*CELL*CELL*2*M_PI/DIRS;}
 bool isgiven(double x,double y){for(auto&g:given)if(hypot(g[0]-x,g[1]-y)<GIVEN)return true;return false;}
 map<int,pair<int,int>> ways(int start,bool narrow,vector<int>&order){vector<int> cost(N*N,1<<30),bef(N*N,-1);vector<vector<int>> b(1);vector<char> done(N*N,0);map<int,pair<int,int>> out;cost[start]=0;bef[start]=start;b[0].push_back(start);
  for(size_t at=0;at<b.size();at++)for(size_t i=0;i<b[at].size();i++){int c=b[at][i];if(done[c])continue;done[c]=1;order.push_back(c);out[c]={bef[c],cost[c]};for(int o:BES){int q=c+o;if(q<4*N||q>=N*(N-4)||!fre(q))continue;bool fits=room(q),nr=fits&&anyocc(q,TWO,8);int s=at+(!fits?NARROW:nr?NEARC:1);bool may=narrow||fits||at<3;if(may&&s<cost[q]){bef[q]=c;cost[q]=s;if((int)b.size()<=s)b.resize(s+1);b[s].push_back(q);}}}
  return out;}
 double novelty(double x,double y){double l=2;for(auto&t:tried)l=min(l,hypot(t[0]-x,t[1]-y));return l;}
 int best(map<int,pair<int,int>>&w,vector<int>&order){int b=-1;double most=0;double nw=par("novel",0);for(int c:order){if((c/N)%3||(c%N)%3)continue;int k=w[c].second;double x,y;mid(c,x,y);if(k<=2||!room(c)||isgiven(x,y))continue;double g=gain(c);double u=g;if(nw>0)u=(g+.5)*(nw*novelty(x,y)+1-nw);if(g<=LEASTG)continue;double pr=pow(u,POW)/(SCOST+CELL*k);if(pr>most)most=pr,b=c;}return b;}
 bool straight(Pose p,int c){double x,y;mid(c,x,y);double dx=x-p.x,dy=y-p.y,d=hypot(dx,dy);for(double a=3*CELL;a<=d;a+=.7*CELL){int q=cell(p.x+dx*a/d,p.y+dy*a/d);if(!(fre(q)&&room(q)))return false;}return true;}
 bool way(Pose p,double&hd,double&dist,int&target,bool&last){for(int n=0;n<2;n++){vector<int> o;int st=cell(p.x,p.y);auto w=ways(st,n,o);int t=best(w,o);if(t<0)continue;target=t;int c=t;while(w[c].first!=st&&!straight(p,c))c=w[c].first;double x,y;mid(c,x,y);hd=atan2(y-p.y,x-p.x);dist=hypot(x-p.x,y-p.y);last=c==t;return true;}return false;}
 void doubt(){gdrop+=given.size();given.clear();for(auto&v:e){if(fabs(v)<1)v=0;else v/=2;}}
 double fit(const vector<int>&E,const vector<vector<int>>&P,int o){double s=0;for(int c:E){int q=c+o;if(occ(q))s+=1;else if(anyocc(q,BES,4))s+=.5;else if(fre(q))s-=.5;}for(auto&v:P)for(int c:v)if(e[c+o]>1){s-=.5;break;}return s;}
 void match(Pose&p,const Rays&rays){double ra=par("ra",0);double bestm=-1e9;Pose bp=p;for(int k=0;k<4;k++){if(k&&ra<=0)break;Pose h=p;h.h+=k*M_PI/2;vector<int> E;vector<vector<int>> P;for(auto&r:rays){if(!r.k)continue;double t=h.h+r.a,dx=cos(t),dy=sin(t);if(r.d<TRUSTED)E.push_back(cell(h.x+r.d*dx,h.y+r.d*dy));vector<int> c;for(double a=2*CELL;a<=min(r.low,TRUSTED)-2*CELL;a+=CELL)c.push_back(cell(h.x+a*dx,h.y+a*dy));P.push_back(c);}
  int bx=0,by=0;double m=fit(E,P,0)+2;for(int x=-7;x<=7;x++)for(int y=-7;y<=7;y++){double as=hypot(x,y);if(as>7)continue;double f=fit(E,P,x*N+y)-1.2*as;if(f>m)m=f,bx=x,by=y;}m-=k?ra:0;if(m>bestm){bestm=m;bp=h;bp.x+=bx*CELL;bp.y+=by*CELL;}}p=bp;}
};
int ideal=0;
Rays scan(const Flat&f,Pose t,double from,double to,double T,double turn){Rays out;int n=120;int b0=(int)round(from/(2*M_PI)*n),b1=(int)round(to/(2*M_PI)*n);
 for(int b=b0;b<b1;b+=12){int m=min(12,b1-b);array<double,12> td{};for(int i=0;i<12;i++)td[i]=par("ws",1)?max(castw(f,t.x,t.y,t.h+(b+i)*2*M_PI/n,T+(b+i)*turn/n),par("tp",0)*(b+i)<72?castw(f,t.x,t.y,t.h+(b+i)*2*M_PI/n,T+(b+i)*turn/n+(par("tp",0)?turn:0)):0):castray(f.s,t.x,t.y,t.h+(b+i)*2*M_PI/n);
  if(ideal){for(int i=0;i<m;i++){Ray r;r.a=(b+i)*2*M_PI/n;r.d=td[i];r.k=1;r.low=td[i];r.near_=.2;r.rec=0;out.push_back(r);}continue;}
  auto s=td;sort(s.begin(),s.end());int k=kb(s[6]);auto it=lib.find(k);if(it==lib.end()){it=lib.lower_bound(k);if(it==lib.end())--it;}auto&v=it->second;double sysp=par("sys",0);mt19937 R2;bool sys=sysp>0&&U()<sysp;if(sys){double mx=t.x+s[6]*cos(t.h+(b+6)*2*M_PI/n),my=t.y+s[6]*sin(t.h+(b+6)*2*M_PI/n);unsigned hsh=(unsigned)(floor(mx/.5)*7919+floor(my/.5)*104729+floor(log(s[6])/.4)*31);R2.seed(hsh);}mt19937&RR=sys?R2:R;const Grp*bg=0;double be=1e9;for(int q=0;q<8;q++){auto&g=v[RR()%v.size()];double er=0;for(int i=0;i<12;i++)er+=fabs(log(max(td[i],.1)/max(g.td[i],.1)));if(er<be)be=er,bg=&g;}
  for(int i=0;i<m;i++){Ray r=bg->r[i];double q=td[i]/max(bg->td[i],.1);r.a=(b+i)*2*M_PI/n;if(r.k){r.d*=q;r.low*=q;}int rm=par("rm",0);if(rm&1&&r.k&&r.d>td[i]+.1){r.d=td[i]+.1;r.low=min(r.low,r.d);}if(rm&2&&r.k&&r.d<td[i]-.1)r.d=max(r.d,td[i]-.1);if(rm&4&&r.k)r.low=max(r.low,r.d);if(rm&8&&!r.k){if(td[i]<3){r.k=1;r.d=td[i];r.low=td[i];}}if(rm&16&&!r.k)continue;if(rm&32&&r.k&&td[i]<.75*r.near_){r.k=0;r.d=.5*r.near_;r.low=.1;}if(rm&64&&r.k&&r.d>td[i]*1.25&&td[i]>=.75*r.near_){r.d=td[i];r.low=td[i];}if(rm&128&&r.k&&r.d<=td[i]*1.25&&r.d>td[i]){r.d=td[i];r.low=min(r.low,td[i]);}if(par("ws",1)==2&&td[i]<castray(f.s,t.x,t.y,t.h+r.a)-.01)continue;out.push_back(r);}}
 int mf=par("minf",0);if(mf&&!ideal){auto o=out;int n=o.size();for(int i=0;i<n;i++)for(int k=-mf;k<=mf;k++){int j=i+k;if(n>=110)j=(j+n)%n;else if(j<0||j>=n)continue;if(o[j].k&&out[i].k&&o[j].d<out[i].d){out[i].d=o[j].d;out[i].low=min(out[i].low,o[j].d);}}}
 return out;}
int main(int c,char**v){for(int i=4;i<c;i++){string s=v[i];auto q=s.find('=');V[s.substr(0,q)]=atof(s.c_str()+q+1);}
 MARG=par("marg",0);OCCW=par("occw",1.5);FREEW=par("freew",1);HOLD=par("hold",0);FAR=par("far",0);PMOST=par("pmost",4);FLIP=par("flip",0);IGN=par("ign",0);BIAS=par("bias",0);SOFT=par("soft",0);SIGHT=par("sight",3);INTO=par("into",6);LEASTG=par("least",.5);SCOST=par("scost",6);POW=par("pow",1);ideal=par("ideal",0);NARROW=par("narrow",4);NEARC=par("nearc",3);
 double range=par("range",4),grantmax=par("grant",40),tsearch=par("search",20),speed=par("speed",.13);int domatch=par("match",1);double percent=par("percent",41.2);
 R.seed(par("seed",1));
 {string t=v[2],g=v[3];stringstream ts(t),gs(g);string a,b;while(getline(ts,a,',')&&getline(gs,b,',')){auto runs=load(a.c_str());auto geo=loadgeo(b.c_str());for(auto&r:runs){auto&s=geo[r.key];for(auto&sg:r.segs)for(auto&q:sg)if(q.tag=='S'&&q.rays.size()>=110){vector<Ray> z=q.rays;for(size_t i=0;i+12<=z.size();i+=4){Grp x;bool ok=true;for(int j=0;j<12;j++){x.r[j]=z[i+j];x.td[j]=castray(s,q.T.x,q.T.y,q.T.h+z[i+j].a);if(x.td[j]>20)ok=false;}if(!ok)continue;auto m=x.td;sort(m.begin(),m.end());lib[kb(m[6])].push_back(x);}}}}}
 vector<Flat> F;{ifstream in(v[1]);Flat f;int n,nw;while(in>>f.k>>f.x>>f.y>>f.h>>f.bat>>f.sx>>f.sy>>f.sh>>f.W>>f.D>>n>>nw){f.wk.clear();for(int i=0;i<nw;i++){Walk w;int m;in>>w.r>>w.v>>w.p>>m;w.w.resize(m);for(auto&p:w.w)in>>p[0]>>p[1];f.wk.push_back(w);}f.s.resize(n);for(auto&s:f.s)in>>s[0]>>s[1]>>s[2]>>s[3];F.push_back(f);}}
 int maxf=par("n",600);if((int)F.size()>maxf)F.resize(maxf);
 map<int,vector<double>> pe,he;int home=0,h0=0,h1=0,n0=0,n1=0;double searches=0,vain=0,gr=0,tt=0,mv=0,falseo=0,walls=0;vector<double> times;int repeats=par("reps",1);int total=0;
 for(int rep=0;rep<repeats;rep++)for(auto&f:F){total++;Ex m;Pose t={f.x,f.y,f.h},b={0,0,0};b.h=0;double T=f.bat*percent;double clock=0;set<int> seen;vector<double> ser;bool ok=false;int ns=0;
  m.stand(b);
  while(clock<T){clock+=tsearch*(hears(f,t.x,t.y,range)?1.5:1);searches++;ns++;
   if(hears(f,t.x,t.y,range)&&U()<par("dock",.85)){ok=true;break;}
   // true new floor
   {int nw=0;for(int d=0;d<90;d++){double a=d*4*M_PI/180;double r=min(3.,castray(f.s,t.x,t.y,a));for(double w=.1;w<r;w+=.1){int q=(int)((t.x+w*cos(a))/.15)*1000+(int)((t.y+w*sin(a))/.15);if(seen.insert(q).second)nw++;}}
    gr++;if(nw*.0225<1.5)vain++;ser.push_back(nw*.0225);}
   double dh=G(.03);b.h+=0; // the search turns the robot by an unknown angle, recovered with an error
   {double turn=U()*2*M_PI;t.h+=turn;b.h+=turn+(ideal?0:dh*par("hs",1)+(U()<par("slip",0)?G(.8):0));if(par("align",1)&&!ideal){Pose st={f.x,f.y,f.h};Pose q=rel(st,t);double er=wrap(b.h-q.h);double k=round(er/(M_PI/2))*M_PI/2;b.h+=k+G(.02)-er;}}
   Rays s=scan(f,t,0,2*M_PI,clock-14,12);
   if(!ideal){/* walls align the heading */}
   if(domatch&&!ideal)m.match(b,s);
   {double dc=par("dec",1);if(dc<1)for(auto&x:m.e)if(x>0)x*=dc;int ge=par("gexp",0);if(ge){m.gcount.push_back(m.given.size()+m.gdrop);if((int)m.gcount.size()>ge){int k=m.gcount[m.gcount.size()-1-ge]-m.gdrop;if(k>0&&k<=(int)m.given.size()){m.given.erase(m.given.begin(),m.given.begin()+k);m.gdrop+=k;}}}}int fb=0;for(auto&x:m.e)if(x<-LEAST)fb++;m.enter(b,s,1);m.stand(b);if(par("o1",0)){for(int i=0;i<180;i++){double a=i*2*M_PI/180,r=min(3.,castray(f.s,t.x,t.y,t.h+a));for(double w=0;w<r-.05;w+=.1)m.searched[m.cell(b.x+w*cos(b.h+a),b.y+w*sin(b.h+a))]=1;}m.tried.push_back({b.x,b.y});}else if(par("o3",0)){for(auto&r:s){double L=min(r.d*(1-MARG*.5),3.);for(double w=0;w<L;w+=.1)m.searched[m.cell(b.x+w*cos(b.h+r.a),b.y+w*sin(b.h+r.a))]=1;}m.tried.push_back({b.x,b.y});}else m.search(b);{int fa=0;for(auto&x:m.e)if(x<-LEAST)fa++;double nf=(fa-fb)*CELL*CELL;m.poses.push_back(b);if(nf<par("sth",1))m.stuck++;else m.stuck=0;int pol=par("pol",0);if(pol&&m.stuck>=par("sk",2)){m.stuck=0;auto redo=[&](double r){fill(m.searched.begin(),m.searched.end(),0);for(auto&p:m.poses){int c0=m.cell(p.x,p.y);m.sight(c0,m.all,[&](int c,int w){if(w*CELL<=r)m.searched[c]=1;});}};if(pol==1)redo(3);if(pol==2)fill(m.searched.begin(),m.searched.end(),0);if(pol==3){double h=0;(void)h;m.clear();m.enter(b,s,1);m.stand(b);m.search(b);m.poses.push_back(b);}if(pol==4)m.doubt();if(pol==5)redo(1.5);if(pol==6){redo(2);m.doubt();}if(pol==7){m.doubt();m.doubt();}if(pol==8)redo(2.2);}}{Pose st={f.x,f.y,f.h};Pose q=rel(st,t);pe[min(ns/4,4)].push_back(hypot(q.x-b.x,q.y-b.y));he[min(ns/4,4)].push_back(fabs(wrap(q.h-b.h))*57.3);}
   if(par("v",0))printf("%s ns %d clock %.0f of %.0f at %.2f %.2f hears %d\n",f.k.c_str(),ns,clock,T,t.x,t.y,hears(f,t.x,t.y,range));double left=grantmax;int failed=0;double moved=0;
   while(left>1){double hd,dist;int tg;bool last;if(failed>=3)break;if(!m.way(b,hd,dist,tg,last)){m.doubt();break;}
    double turn=wrap(hd-b.h);left-=fabs(turn)/.55+1;t.h+=turn+G(ideal?0:par("th",.05))*min(1.,fabs(turn))*(failed||moved>0?1:.3);b.h+=turn;
    double go=0,lim=.8;bool blk=false;double scale=1+(ideal?0:G(par("ds",.06)));
    while(go<dist&&left>0){double fr=9;for(double o=-.12;o<.13;o+=.12)fr=min(fr,par("wc",1)?castw(f,t.x-o*sin(t.h),t.y+o*cos(t.h),t.h,clock+grantmax-left):castray(f.s,t.x-o*sin(t.h),t.y+o*cos(t.h),t.h));if(fr<.3){blk=true;break;}
     if(near_wall(f,t.x+.05*cos(t.h),t.y+.05*sin(t.h))<.13){blk=true;break;}
     double st=min(.1,dist-go);go+=st;left-=st/speed;b.x+=st*cos(b.h);b.y+=st*sin(b.h);t.x+=st*scale*cos(t.h);t.y+=st*scale*sin(t.h);
     // evade walls beside: slide
     lim+=st;if(lim>=.3){lim=0;Rays z=scan(f,t,-.45,.45,clock+grantmax-left,0),k;for(auto&r:z)if(r.d<2)k.push_back(r);m.enter(b,k,2);m.stand(b);}}
    moved+=go;mv+=go;if(par("v",0))printf("   way hd %.2f dist %.2f last %d go %.2f blk %d true %.2f %.2f h %.2f near %.2f left %.1f gain %.2f\n",hd,dist,last,go,blk,t.x,t.y,t.h,near_wall(f,t.x,t.y),left,m.gain(tg));
    if(blk){m.given.push_back({0,0});m.mid(tg,m.given.back()[0],m.given.back()[1]);if(go<.1){failed++;}
      // evades: turns aside and goes on a bit
      double a=(U()<.5?1:-1)*.7;for(int k=0;k<4&&left>0;k++){double fr=castray(f.s,t.x,t.y,t.h+a);if(fr>.5){t.h+=a;b.h+=a;left-=fabs(a)/.55;double st=min(.3,fr-.4);t.x+=st*cos(t.h);t.y+=st*sin(t.h);b.x+=st*cos(b.h);b.y+=st*sin(b.h);left-=st/speed;m.stand(b);break;}a=-a*1.4;}
    }
    else if(last&&go>=dist-1e-6&&m.gain(m.cell(b.x,b.y))>LEASTG)break;}
   clock+=grantmax-max(0.,left)+2;
  }
  if(!ok&&par("series",0)){printf("%s",f.k.substr(f.k.size()-6).c_str());for(double x:ser)printf(" %.1f",x);puts("");}(f.wk.empty()?h0:h1)+=ok;(f.wk.empty()?n0:n1)++;home+=ok;if(ok)times.push_back(clock);tt+=clock;
 }
 sort(times.begin(),times.end());
 for(auto&[k,v]:pe){sort(v.begin(),v.end());sort(he[k].begin(),he[k].end());printf("%.2f/%.2f h%.0f/%.0f  ",v[v.size()/2],v[v.size()*9/10],he[k][v.size()/2],he[k][v.size()*9/10]);}puts("");
 printf("without walker %.1f with %.1f ",100.*h0/max(1,n0),100.*h1/max(1,n1));printf("home %.1f %% (%d) searches %.1f vain %.0f %% moved/grant %.2f cycle %.1f median %.0f p90 %.0f\n",100.*home/total,total,searches/total,100*vain/gr,mv/gr,tt/searches,times[times.size()/2],times[times.size()*9/10]);
}
