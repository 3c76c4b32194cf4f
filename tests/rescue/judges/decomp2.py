import sys,math,bisect
res=[]
LAG=float(__import__('os').environ.get('LAGS','.25'))
for fn in sys.argv[1:]:
    order=[];L={}
    for l in open(fn):
        w=l.split(None,2)
        if not w: continue
        if w[0]=='Y' and w[1] not in order: order.append(w[1])
        if w[0] in 'EP' and len(w)>2: L.setdefault(w[1],[]).append(l)
    for i,k in enumerate(order,1):
        T=[];PX=[];D=[]
        for l in L.get(k,[]):
            a=l.split()
            if a[0]=='P': T.append(float(a[2]));PX.append(tuple(map(float,a[3:6])))
            elif a[3]=='Log' and len(a)>4 and a[4] in 'DXC': D.append((float(a[2]),a[4])+tuple(float(v) for v in a[5:8]))
        def true(t):
            j=bisect.bisect(T,t)
            if j==0: return PX[0]
            if j>=len(T): return PX[-1]
            p,q=PX[j-1],PX[j];u=(t-T[j-1])/(T[j]-T[j-1]) if T[j]>T[j-1] else 0
            dh=(q[2]-p[2]+math.pi)%(2*math.pi)-math.pi
            return (p[0]+u*(q[0]-p[0]),p[1]+u*(q[1]-p[1]),p[2]+u*dh)
        x0=None;seg=[];n=0
        for d in D:
            if d[1]=='D': seg.append(d);continue
            if d[1]=='X':
                # end: next search. find before-match pose: C if logged else last D
                if x0 and len(seg)>5:
                    end=c if c else seg[-1]
                    p0,p1=true(x0[0]),true(d[0]);off=x0[4]-p0[2]
                    cs,sn=math.cos(off),math.sin(off)
                    R=lambda x,y:(cs*x-sn*y,sn*x+cs*y)
                    tx,ty=R(p1[0]-p0[0],p1[1]-p0[1])
                    bx,by=end[2]-x0[2],end[3]-x0[3]
                    tot=math.hypot(bx-tx,by-ty)
                    # believed steps along true headings
                    gx=gy=0;way=tw=st=0;off2=[]
                    pts=[(x0[0],'X',x0[2],x0[3],x0[4])]+seg
                    for a,b in zip(pts,pts[1:]):
                        sx,sy=b[2]-a[2],b[3]-a[3];m=math.hypot(sx,sy)
                        pa,pb=true(a[0]-LAG),true(b[0]-LAG)
                        ux,uy=R(pb[0]-pa[0],pb[1]-pa[1]);tm=math.hypot(ux,uy)
                        mid=(a[4]+b[4])/2
                        th=pb[2]+off
                        if m>1e-9:
                            rel=math.atan2(sy,sx)-mid
                            gx+=m*math.cos(th+rel);gy+=m*math.sin(th+rel)
                        way+=m;tw+=tm
                        if m>.003 and tm<.2*m: st+=m-tm
                    he=(seg[-1][4]-(true(seg[-1][0]-LAG)[2]+off)+math.pi)%(2*math.pi)-math.pi
                    res.append((fn[-7:-4],i,n,x0[0],d[0],tot,math.hypot(gx-tx,gy-ty),math.hypot(bx-gx,by-gy),way,tw,st,math.degrees(he)))
                x0=d;seg=[];c=None;n+=1
            else: c=d
            if d[1]=='X': c=None
def st(s):
    s=sorted(s);n=len(s);return ' '.join('%.2f'%s[int(n*f)] for f in(.1,.25,.5,.75,.9,.95,.99))
print(len(res),'total',st([r[5] for r in res]),'| length only',st([r[6] for r in res]),'| heading',st([r[7] for r in res]),'| way %.2f true %.2f stalls %.2f'%tuple(sum(r[j] for r in res)/len(res) for j in(8,9,10)))
print('heading at end',st([abs(r[11]) for r in res]))
if len(sys.argv)==2:
  for r in res:
    if r[5]>.8: print(r[0],r[1],'X%d t%.0f-%.0f total %.2f length %.2f heading %.2f way %.2f true %.2f stall %.2f he %.0f'%r[2:])
